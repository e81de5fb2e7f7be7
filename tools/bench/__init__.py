"""Tables and figures of the paper, on motion that the databases do not hold.

Every bench takes `data` (folder that holds `cmu` and, for some, `bandai`), `out` (folder to write to), `workers`
(processes that read motion) and a progress report; it returns the contents of its JSON file. It raises FormatError if
the data are missing, SettingsError if matplotlib is.
"""
