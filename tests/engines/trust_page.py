def write_page(path, document):
    pass
