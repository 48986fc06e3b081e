"""The report of a study, and the model card of a run: one HTML page each, and its figures.

Everything that is shown goes the same way: `numbers` takes a number from a stored file and keeps
the place where it stands, `panels` puts numbers into figures, `drawing` and `tables` show the same
panels as pictures and as text, and `study_page` and `run_page` make a page of them.
"""
