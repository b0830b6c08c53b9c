"""``python3 -m driver``"""

import sys

from . import environment
from .errors import defect, report_error, shortage

environment.prepare_libraries()  # before anything loads the library that reads it
try:
    environment.heed_interrupts()
    from .cli import main

    main()
except KeyboardInterrupt:  # before main could handle it, or once more while it did
    sys.exit(130)
except ImportError as problem:
    report_error(environment.package_error(problem))
    sys.exit(2)
except Exception as problem:
    report_error(shortage(problem) or defect(problem))
    sys.exit(2 if shortage(problem) else 1)
