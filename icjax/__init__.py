"""icjax: interaction capture and synthesis, differentiable, in JAX.

Importing this package changes no global setting and imports no heavy dependency.
"""

__version__ = "0.1.0"
