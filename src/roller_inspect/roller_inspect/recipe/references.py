"""The reference that a recipe names."""

from __future__ import annotations

from roller_inspect.references import NominalReference, Reference, SelfReference

from .recipe import Recipe


def load_reference(recipe: Recipe) -> Reference:
    """Read what a recipe's reference names.

    Raises
    ------
    ReferenceError
        If it can't be read.
    """
    chosen = recipe.reference
    if chosen.kind == "nominal":
        return NominalReference(chosen.form)
    return SelfReference()
