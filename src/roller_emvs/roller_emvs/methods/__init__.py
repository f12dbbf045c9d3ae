"""The depth methods: the paper's, focus, and the sweep in the surface's frame."""
