"""The reference that a recipe names."""

from __future__ import annotations

from pathlib import Path

from roller_inspect.references import (
    CadReference,
    GoldenReference,
    NominalReference,
    Reference,
    SelfReference,
)

from .recipe import Recipe


def load_reference(recipe: Recipe) -> Reference:
    """Read what a recipe's reference names; CAD lies in the recipe's frame.

    Raises
    ------
    ReferenceError
        If it can't be read.
    """
    chosen = recipe.reference
    if chosen.kind == "nominal":
        return NominalReference(chosen.form)
    if chosen.kind == "golden":
        return GoldenReference.load(Path(chosen.path))
    if chosen.kind == "cad":
        return CadReference.load(Path(chosen.path), recipe.base_from_recipe)
    return SelfReference()
