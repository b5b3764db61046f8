"""A storey seen from above: from metres to pixels, and its free floor as SVG, for every drawing that needs them."""
