"""The methods and the search of Chai and Hodgins 2005, for comparison with the method "best"."""
