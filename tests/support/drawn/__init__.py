"""Rigs drawn at random, and what is true of them."""
