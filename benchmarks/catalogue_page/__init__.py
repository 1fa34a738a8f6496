"""The page of the catalogue, ``docs/catalogue.md``, and its pictures.

`cases` what is hidden for each family, and what its residual is drawn against; `residuals` simulates, fits and takes
the residual; `drawing` makes a picture of it; `page` writes the text from the catalogue.
"""
