"""A simulated performer: full-body motion from a model, without recorded data."""

from .performance import BEHAVIOURS, demo_performance, perform, performance
from .style import STYLES, Style, style_named

__all__ = ["BEHAVIOURS", "STYLES", "Style", "demo_performance", "perform", "performance", "style_named"]
