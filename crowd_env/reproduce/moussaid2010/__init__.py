"""Moussaïd, Perozo, Garnier, Helbing, Theraulaz 2010: The walking behaviour of pedestrian social groups."""
