"""A storey seen from above: its free floor, metres to pixels, colours of values, and SVG, for every drawing."""
