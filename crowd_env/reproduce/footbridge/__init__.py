"""The crowd on a footbridge: Strogatz et al. 2005 and Belykh et al. 2021, with walkers who touch."""
