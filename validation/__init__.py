"""Is it true: simulations beside recorded experiments, laws and other commits; and the figures of docs/.

``python -m validation --help`` lists the commands, ``python -m validation cases --help`` the cases.  Recordings are not part of
the repository: each case names where its data comes from and reads them from a folder that the user gives.
"""
