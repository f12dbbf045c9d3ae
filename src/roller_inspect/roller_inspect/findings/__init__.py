"""What differs from the reference: places, kinds, sizes and their uncertainty."""

from .finder_settings import Limits
from .finding import KINDS, Finding, Kind
from .uncertainty import CellUncertainty, Uncertainty

__all__ = ["KINDS", "CellUncertainty", "Finding", "Kind", "Limits", "Uncertainty"]
