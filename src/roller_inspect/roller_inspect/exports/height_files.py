"""Height maps as X3P (ISO 25178-72, a zip of XML and numbers) and SDF (ISO 25178-71, text)."""

from __future__ import annotations

import hashlib
import zipfile
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import numpy.typing as npt

_MAIN = """<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2" \
xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" \
xsi:schemaLocation="http://www.opengps.eu/2008/ISO5436_2 \
http://www.opengps.eu/2008/ISO5436_2/ISO5436_2.xsd">
  <Record1>
    <Revision>ISO5436 - 2000</Revision>
    <FeatureType>SUR</FeatureType>
    <Axes>
      <CX><AxisType>I</AxisType><DataType>D</DataType>\
<Increment>{dx!r}</Increment><Offset>{x0!r}</Offset></CX>
      <CY><AxisType>I</AxisType><DataType>D</DataType>\
<Increment>{dy!r}</Increment><Offset>{y0!r}</Offset></CY>
      <CZ><AxisType>A</AxisType><DataType>F</DataType>\
<Increment>1</Increment><Offset>0</Offset></CZ>
    </Axes>
  </Record1>
{about}  <Record3>
    <MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension>
    <DataLink><PointDataLink>bindata/data.bin</PointDataLink>\
<MD5ChecksumPointData>{md5}</MD5ChecksumPointData></DataLink>
  </Record3>
  <Record4><ChecksumFile>md5checksum.hex</ChecksumFile></Record4>
</p:ISO5436_2>
"""
#: The schema wants a date of calibration in this record, not the record.
_ABOUT = """  <Record2>
    <Date>{date}</Date>
    <Instrument><Manufacturer>roller inspection workspace</Manufacturer>\
<Model>event-camera tactile roller</Model><Serial>-</Serial><Version>{version}</Version>\
</Instrument>
    <CalibrationDate>{calibrated}</CalibrationDate>
    <ProbingSystem><Type>NonContacting</Type><Identification>soft skin, optical</Identification>\
</ProbingSystem>
    <Comment>{comment}</Comment>
  </Record2>
"""


def write_x3p(
    path: Path,
    x_m: npt.NDArray[np.float64],
    y_m: npt.NDArray[np.float64],
    height_m: npt.NDArray[np.float32],
    version: str = "0",
    comment: str = "",
    calibrated: str = "",
) -> None:
    """Write a height map as X3P.

    Parameters
    ----------
    path : path
        The file.
    x_m, y_m : ndarray, shapes (nx,), (ny,)
        Places of columns and rows, evenly spaced, metres.
    height_m : ndarray of float32, shape (ny, nx)
        Metres; NaN where there is none.
    version, comment : str
        Of the software; for people.
    calibrated : str
        When the instrument was, as ISO 8601; empty: not known, and the file says nothing of the
        instrument.
    """
    data = np.ascontiguousarray(height_m, "<f4").tobytes()
    about = _ABOUT.format(
        date=datetime.now(timezone.utc).isoformat(timespec="seconds"), version=_escaped(version),
        comment=_escaped(comment), calibrated=_escaped(calibrated),
    )  # fmt: skip
    text = _MAIN.format(
        dx=_spacing(x_m), dy=_spacing(y_m), x0=float(x_m[0]), y0=float(y_m[0]),
        nx=len(x_m), ny=len(y_m), md5=hashlib.md5(data, usedforsecurity=False).hexdigest().upper(),
        about=about if calibrated else "",
    )  # fmt: skip
    main = text.encode()
    total = hashlib.md5(main, usedforsecurity=False).hexdigest()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("main.xml", main)
        file.writestr("bindata/data.bin", data)
        file.writestr("md5checksum.hex", f"{total} *main.xml\n")


def _spacing(values: npt.NDArray[np.float64]) -> float:
    return float(np.diff(values).mean()) if len(values) > 1 else 1.0


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


#: Heights in SDF are whole numbers of this, metres.
_STEP_M = 1e-9


def write_sdf(
    path: Path,
    x_m: npt.NDArray[np.float64],
    y_m: npt.NDArray[np.float64],
    height_m: npt.NDArray[np.float32],
) -> None:
    """Write a height map as SDF; parameters as of `write_x3p`."""
    now = f"{datetime.now(timezone.utc):%d%m%Y%H%M}"
    head = {
        "ManufacID": "roller",
        "CreateDate": now,
        "ModDate": now,
        "NumPoints": len(x_m),
        "NumProfiles": len(y_m),
        "Xscale": f"{_spacing(x_m):.9e}",
        "Yscale": f"{_spacing(y_m):.9e}",
        "Zscale": f"{_STEP_M:.9e}",
        "Zresolution": -1,
        "Compression": 0,
        "DataType": 6,  # 32-bit whole numbers
        "CheckType": 0,
    }
    with path.open("w", encoding="ascii") as file:
        file.write("aISO-1.0\n")
        file.writelines(f"{name:<12}= {value}\n" for name, value in head.items())
        file.write("*\n")
        for row in height_m.astype(np.float64) / _STEP_M:
            file.write(" ".join("BAD" if v != v else str(round(v)) for v in row.tolist()) + "\n")
        file.write("*\n")
