"""Many recordings: one job each, on one machine or by a Dask scheduler."""
