// Links to recordings open them in the viewer beside this page; it needs a whole address.
for (const link of document.querySelectorAll("a[data-recording]")) {
  const source = encodeURIComponent(new URL(link.getAttribute("href"), document.baseURI).href);
  link.href = `viewer/index.html?url=${source}&hide_welcome_screen=1&persist=0`;
}
