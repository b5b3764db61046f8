"""One scan in the browser, without any episode: look at its storeys, point, measure, walk."""
