// The frame around all slices: navigation, jobs, messages, and the word that the server is gone.

import { useEffect, useRef } from "react";

import { switchTheme } from "../../../../analysis/report/page/src/theme.js";
import { useConnection } from "./connection";
import { JobsButton } from "./jobs";
import { ROUTES } from "./routes";
import { href, usePlace } from "./routing";
import { Icon } from "./ui/Icon";
import { Empty } from "./ui/Empty";
import { Toasts } from "./ui/Toast";

export function App() {
  const place = usePlace();
  const connection = useConnection();
  const route = ROUTES.find((each) => each.name === place.name);
  const main = useRef<HTMLElement>(null);
  const title = route ? route.title(place) : "Not found";
  useEffect(() => {
    document.title = title ? `${title} · picktree studio` : "picktree studio";
  }, [title]);
  const key = `${place.name}/${place.rest}`;
  const before = useRef(key);
  useEffect(() => {
    if (before.current !== key) main.current?.focus();
    before.current = key;
  }, [key]);
  return (
    <>
      <a className="skip" href="#main" onClick={(event) => { event.preventDefault(); main.current?.focus(); }}>Skip to the content</a>
      <header className="frame">
        <a className="brand" href="#/" aria-label="picktree studio, start">
          <svg viewBox="0 0 24 24" aria-hidden="true"><path d="M12 3v5M12 8H5.5v4M12 8h6.5v4M5.5 12v0M5.5 16v0" /><circle cx="12" cy="4" r="2" /><circle cx="5.5" cy="14" r="2.2" /><circle cx="18.5" cy="14" r="2.2" /><path d="M18.5 16.2V20M16 20h5" /></svg>
          <span>studio</span>
        </a>
        <nav aria-label="Parts of the studio">
          {ROUTES.filter((each) => each.nav).map((each) => (
            <a key={each.name} href={href(each.name)} aria-current={each === route || each.covers?.includes(place.name) ? "page" : undefined}>{each.nav}</a>
          ))}
        </nav>
        <span className="space" />
        <JobsButton />
        <button className="icon" title="Light or dark" aria-label="Light or dark" onClick={switchTheme}><Icon name="theme" /></button>
      </header>
      {connection === "lost" && (
        <p className="lost" role="alert">The studio does not answer. Runs go on without it; start <code>picktree studio</code> again, and this page finds it.</p>
      )}
      <main id="main" ref={main} tabIndex={-1}>
        {route ? <route.Component place={place} key={key} /> : <Empty title="There is no such page here"><a href="#/">To the start</a></Empty>}
      </main>
      <Toasts />
    </>
  );
}
