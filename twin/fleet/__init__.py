"""The diagnosis of many rigs: side by side, one folder of results each, and one page over all of them."""
