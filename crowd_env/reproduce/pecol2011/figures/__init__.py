"""How the figures of Pécol et al. 2011 are drawn."""
