"""A simulated performer: full-body motion from a model, without recorded data."""

from .performance import BEHAVIOURS, perform, performance
from .style import STYLES, Style

__all__ = ["BEHAVIOURS", "STYLES", "Style", "perform", "performance"]
