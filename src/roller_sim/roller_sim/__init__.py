"""The virtual cell: a model of the roller over a relief, from the light on its skin to packets."""
