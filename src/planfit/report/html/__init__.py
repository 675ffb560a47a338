"""The report as one self-contained HTML page: its sections, its tables, and their style."""
