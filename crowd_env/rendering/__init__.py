"""Frames, films and figures of evacuations; the drawing libraries are loaded when something is drawn."""
