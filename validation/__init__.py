"""Is it true: simulations beside recorded experiments, laws and other commits, one file a case.

``python -m validation`` lists the cases.  Recordings are not part of the repository: each case names where its data comes
from and reads them from a folder that the user gives.
"""
