"""A home as participants see it: scene, pictures and browser copies, opened when a trial needs them."""
