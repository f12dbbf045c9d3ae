"""What differs from the reference: places, kinds, sizes and their uncertainty."""

from .finding import KINDS, Finding, Kind, Uncertainty
from .limits import Limits

__all__ = ["KINDS", "Finding", "Kind", "Limits", "Uncertainty"]
