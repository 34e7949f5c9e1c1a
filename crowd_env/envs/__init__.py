"""Environments: observations, actions, rewards and episodes over a simulation."""
