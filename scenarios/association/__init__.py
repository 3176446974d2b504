"""Channel association after Ivanov & Shell (2014, 2016)."""
