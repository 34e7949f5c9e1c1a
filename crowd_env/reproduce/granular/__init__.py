"""Granular matter under gravity, what the schemes without a desired velocity were made for: section 2 of Pécol et al. 2011."""
