"""Reading a recipe."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from roller_core.errors import SettingsError
from roller_core.text_file import TextFileError, read_yaml

from .recipe import Recipe


class RecipeError(SettingsError):
    """A recipe that can't be read, or that names what is not there."""


def load_recipe(path: Path | None = None, reference: str | None = None) -> Recipe:
    """Read a recipe and see that what it names is there.

    Parameters
    ----------
    path : path, optional
        YAML file; without it the default recipe.
    reference : str, optional
        Goes before the recipe's: `self`, `nominal`, `nominal:cylinder`, `golden:DIR`,
        `cad:FILE`; its path counts from the working folder.

    Raises
    ------
    RecipeError
        In one line: the file, the entry, what is wrong.
    """
    source, values = "recipe", {}
    if path is not None:
        source = f"recipe {path}"
        try:
            values = read_yaml(path)
        except TextFileError as error:
            raise RecipeError(f"recipe {error}") from error
        if not isinstance(values, Mapping):
            raise RecipeError(f"{source}: expected entries such as 'regions:' and 'tolerances:'")
    folder = path.parent if path is not None else Path()
    try:
        recipe = Recipe.create(values, source)
        if reference is not None:
            folder, source = Path(), "--reference"
            Recipe.create({"reference": reference}, source)
            recipe = recipe.changed({"reference": reference})
    except SettingsError as error:
        raise RecipeError(str(error)) from error
    kind, named = recipe.reference.kind, recipe.reference.path
    if not named:
        return recipe
    there = folder / named
    if not (there.is_dir() if kind == "golden" else there.is_file()):
        what = "folder" if kind == "golden" else "file"
        raise RecipeError(f"{source}: the reference '{recipe.reference}': no such {what} {there}")
    return recipe.changed({"reference": {"path": str(there)}})
