"""The documentation as a site with search: sphinx-build -W docs FOLDER."""

from __future__ import annotations

project = html_title = "Trocar"
html_theme = "furo"
extensions = ["myst_parser"]
myst_heading_anchors = 4
