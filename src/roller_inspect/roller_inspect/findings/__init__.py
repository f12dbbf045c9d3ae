"""What differs from the reference: places, kinds, sizes and their uncertainty."""

from .finding import KINDS, Finding, Kind
from .limits import Limits
from .uncertainty import CellUncertainty, Uncertainty

__all__ = ["KINDS", "CellUncertainty", "Finding", "Kind", "Limits", "Uncertainty"]
