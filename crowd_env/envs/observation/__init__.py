"""Observations: named terms of fixed width, laid side by side."""
