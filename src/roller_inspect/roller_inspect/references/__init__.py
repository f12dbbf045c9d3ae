"""What the surface is compared with."""

from .alignment import Alignment
from .background import SelfReference
from .nominal import Form, NominalReference
from .reference import Comparison, Reference, ReferenceError

__all__ = [
    "Alignment",
    "Comparison",
    "Form",
    "NominalReference",
    "Reference",
    "ReferenceError",
    "SelfReference",
]
