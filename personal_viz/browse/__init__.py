"""Parts of `personal-viz browse`: what is listed, how owners and objects are linked, what is drawn."""
