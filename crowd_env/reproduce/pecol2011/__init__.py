"""The tables and figures of Pécol et al. 2011."""
