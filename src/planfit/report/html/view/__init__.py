"""Programs and style of the 3D view, inlined into the report."""
