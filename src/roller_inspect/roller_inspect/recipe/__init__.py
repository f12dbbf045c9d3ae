"""What is inspected and what is allowed: the recipe of a part."""

from .decision import decide, part_verdict
from .load import RecipeError, load_recipe
from .recipe import Recipe
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
