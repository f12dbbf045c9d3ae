"""A STEP file of a box, written by hand (AP214, faceted)."""

import itertools
from collections.abc import Iterable

import numpy as np

from roller_core.transforms import F64

_METRE = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({},.METRE.))"
_UNITS = {
    "mm": _METRE.format(".MILLI."),
    "m": _METRE.format("$"),
    "inch": "(CONVERSION_BASED_UNIT('INCH',#4)LENGTH_UNIT()NAMED_UNIT(#3))",
}
#: Corners of each side, once around, seen from outside.
_SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_REST = """#1={unit};
#2={mm};
#3=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);
#4=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#2);
#5=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#6=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#7=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#5,#6))REPRESENTATION_CONTEXT('',''));
#70=CLOSED_SHELL('',(#60,#61,#62,#63,#64,#65));
#71=FACETED_BREP('',#70);
#72=FACETED_BREP_SHAPE_REPRESENTATION('',(#71),#7);
#80=APPLICATION_CONTEXT('automotive design');
#81=PRODUCT_CONTEXT('',#80,'mechanical');
#82=PRODUCT('box','box','',(#81));
#83=PRODUCT_DEFINITION_FORMATION('','',#82);
#84=PRODUCT_DEFINITION_CONTEXT('part definition',#80,'design');
#85=PRODUCT_DEFINITION('','',#83,#84);
#86=PRODUCT_DEFINITION_SHAPE('','',#85);
#87=SHAPE_DEFINITION_REPRESENTATION(#86,#72);
ENDSEC;
END-ISO-10303-21;
"""


def box_step(corners: F64, unit: str) -> str:
    """A box between its lowest and its highest corner, shape (2, 3), in a unit: mm, m or inch."""
    lines = [
        "ISO-10303-21;", "HEADER;", "FILE_DESCRIPTION((''),'2;1');",
        "FILE_NAME('box','',(''),(''),'','','');", "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));", "ENDSEC;",
        "DATA;",
    ]  # fmt: skip
    for k, corner in enumerate(itertools.product(*corners.T)):
        lines.append(f"#{10 + k}=CARTESIAN_POINT('',{_list(corner)});")
    for k, side in enumerate(_SIDES):
        normal = np.zeros(3)
        normal[k // 2] = 1 if k % 2 else -1
        lines += [
            f"#{20 + k}=POLY_LOOP('',({','.join(f'#{10 + c}' for c in side)}));",
            f"#{30 + k}=DIRECTION('',{_list(normal)});",
            f"#{40 + k}=AXIS2_PLACEMENT_3D('',#{10 + side[0]},#{30 + k},$);",
            f"#{50 + k}=PLANE('',#{40 + k});",
            f"#{90 + k}=FACE_OUTER_BOUND('',#{20 + k},.T.);",
            f"#{60 + k}=FACE_SURFACE('',(#{90 + k}),#{50 + k},.T.);",
        ]
    return "\n".join(lines) + "\n" + _REST.format(unit=_UNITS[unit], mm=_UNITS["mm"])


def _list(values: Iterable[float]) -> str:
    return "(" + ",".join(repr(float(v)) for v in values) + ")"
