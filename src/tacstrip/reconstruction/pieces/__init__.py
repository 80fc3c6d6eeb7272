"""Convex pieces of a contact, from one scan of both signatures."""
