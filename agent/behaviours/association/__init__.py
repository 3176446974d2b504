"""Channel association: which radio voice belongs to which visible light (Ivanov & Shell 2014, 2016)."""
