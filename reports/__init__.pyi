from . import plots as plots
from .pages.study_page import show as show, write_report as write_report
