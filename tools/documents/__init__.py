"""Commands and scripts of the documents: found, parsed and run."""
