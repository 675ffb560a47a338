"""Terms that any problem over poses may need."""
