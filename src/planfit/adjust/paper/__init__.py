"""The paper's adjustment, to the letter: its cost, its weights, its gradient descent."""
