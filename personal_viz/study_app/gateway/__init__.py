"""Our web server in front of viser: it admits people, filters their messages and runs the viser workers."""
