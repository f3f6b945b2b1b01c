"""The names of the files of a page; light, so that a command can look at them before the work."""

PAGE = "index.html"
SCRIPT = "plotly.min.js"
