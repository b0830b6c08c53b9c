"""``python3 -m driver``"""

import os
import sys

for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
    if getattr(sys, name) is None:  # closed: a pipe to a rank would take its number
        setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))
try:
    from . import environment

    environment.heed_interrupts()
    environment.prepare_libraries()  # before anything loads the library that reads it
    from .cli import main

    main()
except KeyboardInterrupt:  # before main could handle it, or once more while it did
    sys.exit(130)
except ImportError as problem:
    from .errors import report_error

    report_error(environment.package_error(problem))
    sys.exit(2)
except Exception as problem:
    from .errors import defect, report_error, shortage

    report_error(shortage(problem) or defect(problem))
    sys.exit(2 if shortage(problem) else 1)
