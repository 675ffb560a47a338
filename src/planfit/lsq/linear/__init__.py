"""The linear equations of a step: blocks, their pattern, and ways to solve them."""
