"""The browser-based Tester: connections, objects, packets, motions and a live view of the arm (RC8 5, VE026A 6).

``state`` contains everything that does not depend on the browser: connections, logged packets, running motions. ``ui``
contains the elements that several pages share. ``pages`` contains one module or folder for each page, and the table of
the pages.
"""
