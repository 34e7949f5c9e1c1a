"""Judge policies, strategies and controllers on the same draws."""
