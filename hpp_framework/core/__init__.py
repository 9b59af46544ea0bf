"""The nouns: data and abstract classes that all rooms share; knows no simulator and no file."""
