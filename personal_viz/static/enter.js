// Trades the token in the link's fragment (never sent in a URL, never logged) for a session, then opens the study.
"use strict";
(async () => {
  const message = document.getElementById("message");
  const token = window.location.hash.slice(1);
  if (!token) {
    message.textContent = "This page needs your personal link. Please open the link that you were given.";
    return;
  }
  try {
    const reply = await fetch("/enter", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ token }),
    });
    if (reply.ok) {
      window.location.replace((await reply.json()).view);
    } else {
      message.textContent = "This link is not known. Please check that you opened all of it.";
    }
  } catch {
    message.textContent = "The study cannot be reached. Please keep this page and try again in a minute.";
  }
})();
