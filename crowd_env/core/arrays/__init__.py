"""Pedestrians as arrays: bodies and state, their shape, the distance that they keep."""
