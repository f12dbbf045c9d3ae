"""What the surface is compared with."""

from .background import SelfReference
from .cad import CadReference
from .golden import GoldenReference, teach
from .nominal import Form, NominalReference
from .reference import Alignment, Comparison, Reference, ReferenceError

__all__ = [
    "Alignment",
    "CadReference",
    "Comparison",
    "Form",
    "GoldenReference",
    "NominalReference",
    "Reference",
    "ReferenceError",
    "SelfReference",
    "teach",
]
