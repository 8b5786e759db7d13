// Names for the theme's regions that have none: screen readers list them by name.
const label = () => {
  document.querySelectorAll("nav.md-code__nav:not([aria-label])").forEach((nav) => {
    label.count = (label.count ?? 0) + 1;
    nav.setAttribute("aria-label", `Tools of code block ${label.count}`);
  });
  document.querySelectorAll("[role=dialog]:not([aria-label])").forEach((one) => {
    one.setAttribute("aria-label", one.matches(".md-search") ? "Search" : "Message");
  });
  document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])").forEach((one) => {
    one.tabIndex = 0; // the keyboard scrolls a wide table
  });
  document.querySelectorAll(".formula:not([tabindex])").forEach((one) => {
    one.tabIndex = 0;
  });
};
new MutationObserver(label).observe(document.documentElement, { childList: true, subtree: true });
label();
