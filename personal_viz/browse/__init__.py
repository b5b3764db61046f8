"""The app `personal-viz browse`: its list of episodes, links of owners with objects, panels and 3-D layers."""
