// The page of the studio. How its parts meet:
//
// Each slice is a folder with an index.tsx that exports `routes` (see routing.ts); routes.tsx lists the slices.
// Calls and watches of the server go through connection.ts; theme.css has the rules that all share, and /page/colours.css
// the palette of drawn trees and reports. Text is React text everywhere: nothing from a file becomes markup.

import "@xyflow/react/dist/style.css";
import "./theme.css";

import { createRoot } from "react-dom/client";

import { startTheme } from "../../../../analysis/report/page/src/theme.js";
import { App } from "./App";
import { loadSymbols } from "./ui/Icon";

startTheme();
void loadSymbols().catch(() => undefined).finally(() => createRoot(document.getElementById("root")!).render(<App />));
