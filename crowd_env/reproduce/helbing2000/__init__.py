"""Faster is slower, after Helbing, Farkas, Vicsek 2000."""
