"""page"""
def render_page(result):
    return ""
