"""Pictures of scenes, drawn by the processor: neither a window system nor a graphics card is needed."""

from .renderer import Renderer

__all__ = ["Renderer"]
