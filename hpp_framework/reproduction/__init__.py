"""The whole paper, reproduced: what is run, how it is judged, and the page that shows it."""
