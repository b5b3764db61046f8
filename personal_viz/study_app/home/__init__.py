"""A home as participants meet it: scene, pictures, browser copies; opened when a trial needs them."""
