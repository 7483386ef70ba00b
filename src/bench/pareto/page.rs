//! Tables and plots as one HTML page without outside requests.

use std::fmt::Write;

use super::chart::svg;
use super::{Table, table::number};
use crate::format::markup::escape;

/// The page. `about` says what was measured, and where.
pub fn page(about: &str, tables: &[Table]) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>Speed against error</title><style>body{{font:15px/1.45 \
         sans-serif;margin:2rem auto;max-width:72rem;padding:0 1rem;color:#222}}table{{border-collapse:collapse;margin:1rem 0}}td,th{{\
         border:1px solid #ccc;padding:.25rem .5rem;text-align:left}}tr.dominated{{color:#888}}svg{{max-width:46rem}}</style></head>\
         <body><h1>Speed against error</h1><p>{}</p><p>A setting is dominated (hollow, grey) where another is better in one of time \
         and error and as good in the other, and gives the same bits every time if this one does. The square is the default.</p>\n",
        escape(about)
    );
    for table in tables {
        let _ = writeln!(out, "<h2>{}</h2>{}", escape(&table.title), svg(std::slice::from_ref(table)));
        let _ = write!(
            out,
            "<table><tr><th>#<th>setting<th>options<th>{}<th>{}",
            escape(&table.time),
            escape(&table.error)
        );
        table.columns.iter().for_each(|column| out += &format!("<th>{}", escape(column)));
        out += "</tr>\n";
        for (s, row) in table.settings.iter().zip(1..) {
            let class = if s.dominated { " class=\"dominated\"" } else { "" };
            let name = if s.default { format!("<b>{}</b>", escape(&s.name)) } else { escape(&s.name) };
            let steady = if s.reproducible { "" } else { " (not to the bit)" };
            let error = s.error.map_or(String::new(), number);
            let _ = write!(
                out,
                "<tr{class}><td>{row}<td>{name}{steady}<td><code>{}</code><td>{}<td>{error}",
                escape(&s.options),
                number(s.time)
            );
            s.more.iter().for_each(|v| out += &format!("<td>{}", number(*v)));
            out += "</tr>\n";
        }
        out += "</table>\n";
    }
    out + "</body></html>\n"
}
