"""State machines of one trial: a command and the time in, events and a view out.

The public names of trial_session.py (the phases of every trial), pan_session.py and pog_session.py (the two tasks).
"""

from .pan_session import STOP_WITHIN_S as STOP_WITHIN_S
from .pan_session import PanSession as PanSession
from .pog_session import PogSession as PogSession
from .terms import RESUME_WITHIN_S as RESUME_WITHIN_S
from .terms import Look as Look
from .terms import TrialTerms as TrialTerms
from .terms import terms_of as terms_of
from .trial_session import CAMERA_EVERY_S as CAMERA_EVERY_S
from .trial_session import GIVE_UP_WITHIN_S as GIVE_UP_WITHIN_S
from .trial_session import RATE_WITHIN_S as RATE_WITHIN_S
