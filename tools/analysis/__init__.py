"""What people do with recordings: choose of them, compare, export, show and drive again what is in them."""
