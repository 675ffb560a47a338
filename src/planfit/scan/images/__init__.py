"""Images of a scan: files, lenses, video, and depth brought to the colour camera."""
