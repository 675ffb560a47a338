"""The same sums on a GPU, through PyTorch."""
