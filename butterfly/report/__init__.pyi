from .identification import write_report as write_report
from .page import Page as Page
from .page import Section as Section
from .page import Table as Table
from .page import write_page as write_page
from .words import sentences as sentences
from .words import sentences_of as sentences_of
