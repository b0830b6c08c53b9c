"""``python3 -m driver``"""

import sys

try:
    from .cli import main

    main()
except KeyboardInterrupt:  # before main could deal with it, or once more while it did
    sys.exit(130)
