"""Terms of the cost function, one file each."""
