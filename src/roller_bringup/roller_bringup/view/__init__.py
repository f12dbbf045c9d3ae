"""The operator's page: what a graph or a result folder has, shown in a browser."""
