"""Columns of clouds as they came."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np

from roller_core.outputs import CloudError
from roller_core.serialized_cloud import SerializedCloud

from .grid import F32


def clouds_of(found: Iterable[bytes], needed: Sequence[str]) -> list[SerializedCloud]:
    """Clouds of serialized messages, those that have points and what is needed of them."""
    clouds = []
    for data in found:
        with suppress(CloudError):
            clouds.append(SerializedCloud.parse(data))
    return [c for c in clouds if len(c.cloud.columns) and set(needed) <= set(c.cloud.names)]


def columns_of(clouds: Sequence[SerializedCloud], needed: Sequence[str]) -> list[F32]:
    """Columns of all of them, each shape (n,)."""
    return [
        np.concatenate([c.cloud.columns[:, c.cloud.names.index(name)] for c in clouds])
        for name in needed
    ]
