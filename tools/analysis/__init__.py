"""Work with recordings: select parts, compare, export, plot and replay them."""
