"""Loading: from the models of files to the document of a system."""
