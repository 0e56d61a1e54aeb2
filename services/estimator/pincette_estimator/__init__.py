"""The estimator: contact force and lumped perturbation without a force sensor."""

from pincette_estimator.step import SERVICE

__all__ = ["SERVICE"]
