"""`trocar attach`: its data from a system, a module a page; `pages/` and `app.py` show them on a terminal."""
