"""The pictures of ``docs/model.md``: the tree of 42 bodies, the frames on the car, the rows of the equations."""
