"""The solver ``riccati``: `core` iterates, `kernels` differentiate, `compiled` compiles both."""
