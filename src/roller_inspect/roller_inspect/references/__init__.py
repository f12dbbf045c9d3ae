"""What the surface is compared with."""

from .alignment import Alignment
from .background import SelfReference
from .cad import CadReference
from .golden import GoldenReference, GoldenScan, teach
from .nominal import Form, NominalReference
from .reference import Comparison, Reference, ReferenceError

__all__ = [
    "Alignment",
    "CadReference",
    "Comparison",
    "Form",
    "GoldenReference",
    "GoldenScan",
    "NominalReference",
    "Reference",
    "ReferenceError",
    "SelfReference",
    "teach",
]
