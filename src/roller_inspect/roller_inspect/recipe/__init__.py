"""What is inspected and what is allowed: the recipe of a part."""

from .decision import decide, part_verdict
from .recipe import Recipe, RecipeError, load_recipe
from .references import load_reference
from .regions import Region

__all__ = [
    "Recipe",
    "RecipeError",
    "Region",
    "decide",
    "load_recipe",
    "load_reference",
    "part_verdict",
]
