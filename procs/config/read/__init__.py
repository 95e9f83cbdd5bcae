"""Reading configuration files as plain values with the line of every key, and searching for them."""
