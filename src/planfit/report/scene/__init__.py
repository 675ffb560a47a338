"""The scene of the report's 3D view: what it shows, and how that is packed into a page."""
