"""``python -m hystid.modelica.library``: write the shipped flat models again."""

from hystid.modelica.library import regenerate

if __name__ == "__main__":
    print(f"{len(regenerate())} flat models written")
