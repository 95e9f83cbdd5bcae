"""`trocar attach`: what it reads of a system, a module a page; `pages/` and `app.py` show it on a terminal."""
