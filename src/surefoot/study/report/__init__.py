"""The report of a study, and the model card of a run: one HTML page each, and its figures.

All content takes the same path: `numbers` takes a number from a stored file and keeps its place
there, `panels` puts numbers into figures, `drawing` and `tables` show the same panels as pictures
and as text, and `study_page` and `run_page` make a page from them.
"""
