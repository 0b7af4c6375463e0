//! A Digital Calibration Certificate: the figures of a test as XML after the schema of PTB, version 3.1.2, values in D-SI.
//!
//! Place in the flow: `abbe conformity --dcc FILE`, after the figures are there. In: [`Product`] and who measured; out: the text.
//! What the schema demands and nobody stated is an error that names the keys: nothing is made up. It is neither signed nor
//! accredited; that is for the laboratory. Micrometres, expanded uncertainties with k = 2.

use super::{Product, verdict_word};
use crate::identity::Who;
use abbe_files::{Contact, Days, PerformedAt};
use anyhow::{Context, ensure};
use std::fmt::Write as _;

/// Version of the schema.
const SCHEMA: &str = "3.1.2";
/// Coverage of k = 2 for a normal distribution, as data sheets state it.
const PROBABILITY: &str = "0.95";

/// The certificate.
///
/// # Errors
/// What the schema demands and is not stated, by its keys; a test without figures.
pub(crate) fn text(who: &Who, product: &Product) -> anyhow::Result<String> {
    ensure!(!product.figures.is_empty(), "this test has no figures for a certificate");
    let wanted = Wanted::of(who)?;
    let days = Days::parse(&wanted.measured).context("identity.measured")?;
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "<dcc:digitalCalibrationCertificate xmlns:dcc=\"https://ptb.de/dcc\" xmlns:si=\"https://ptb.de/si\" \
         xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"https://ptb.de/dcc https://ptb.de/dcc/v{SCHEMA}/dcc.xsd\" schemaVersion=\"{SCHEMA}\">"
    );
    out.push_str("<dcc:administrativeData>\n");
    let _ = writeln!(out, "<dcc:dccSoftware>{}</dcc:dccSoftware>", program());
    let _ = writeln!(
        out,
        "<dcc:coreData><dcc:countryCodeISO3166_1>{}</dcc:countryCodeISO3166_1>\
         <dcc:usedLangCodeISO639_1>en</dcc:usedLangCodeISO639_1>\
         <dcc:mandatoryLangCodeISO639_1>en</dcc:mandatoryLangCodeISO639_1>\
         <dcc:uniqueIdentifier>{}</dcc:uniqueIdentifier>\
         <dcc:beginPerformanceDate>{}</dcc:beginPerformanceDate><dcc:endPerformanceDate>{}</dcc:endPerformanceDate>\
         <dcc:performanceLocation>{}</dcc:performanceLocation></dcc:coreData>",
        escape(&wanted.country),
        escape(&wanted.certificate),
        days.first,
        days.last,
        performed_at(who.stated.performed_at)
    );
    let _ = writeln!(
        out,
        "<dcc:items><dcc:item>{}<dcc:manufacturer>{}</dcc:manufacturer><dcc:model>{}</dcc:model>\
         <dcc:identifications><dcc:identification><dcc:issuer>manufacturer</dcc:issuer><dcc:value>{}</dcc:value>{}\
         </dcc:identification></dcc:identifications></dcc:item></dcc:items>",
        name("Coordinate measuring machine"),
        name(&wanted.maker),
        escape(&wanted.model),
        escape(&wanted.serial_number),
        name("serial number")
    );
    let _ = writeln!(
        out,
        "<dcc:calibrationLaboratory><dcc:contact>{}</dcc:contact></dcc:calibrationLaboratory>",
        contact(&wanted.laboratory)
    );
    let _ = writeln!(
        out,
        "<dcc:respPersons><dcc:respPerson><dcc:person>{}</dcc:person><dcc:mainSigner>true</dcc:mainSigner></dcc:respPerson>\
         </dcc:respPersons>",
        name(&wanted.operator)
    );
    let _ = writeln!(out, "<dcc:customer>{}</dcc:customer>\n</dcc:administrativeData>", contact(&wanted.customer));
    results(who, product, &mut out);
    out.push_str("</dcc:digitalCalibrationCertificate>\n");
    Ok(out)
}

fn results(who: &Who, product: &Product, out: &mut String) {
    let lead = product.report.lead.as_deref().unwrap_or_default();
    let _ = writeln!(
        out,
        "<dcc:measurementResults><dcc:measurementResult>{}<dcc:description>{}</dcc:description>",
        name(&product.report.title),
        content(lead)
    );
    let (standard, departures) = &product.method;
    let whole = match departures.as_slice() {
        [] => "a whole test after this standard".to_owned(),
        list => format!("not a whole test after this standard, so that nothing is verified by it: {}", list.join("; ")),
    };
    let _ = writeln!(
        out,
        "<dcc:usedMethods><dcc:usedMethod>{}<dcc:description>{}</dcc:description><dcc:norm>{standard}</dcc:norm>\
         </dcc:usedMethod></dcc:usedMethods>\n<dcc:usedSoftware>{}</dcc:usedSoftware>",
        name(standard),
        content(&whole),
        program()
    );
    let instrument = who.stated.instrument.clone().unwrap_or_default();
    if let Some(named) = &instrument.name {
        let _ = write!(out, "<dcc:measuringEquipments><dcc:measuringEquipment>{}", name(named));
        if let Some(serial) = &instrument.serial_number {
            let _ = write!(
                out,
                "<dcc:identifications><dcc:identification><dcc:issuer>manufacturer</dcc:issuer><dcc:value>{}</dcc:value>{}\
                 </dcc:identification></dcc:identifications>",
                escape(serial),
                name("serial number")
            );
        }
        out.push_str("</dcc:measuringEquipment></dcc:measuringEquipments>\n");
    }
    conditions(who, out);
    out.push_str("<dcc:results>\n");
    for figure in &product.figures {
        let said = [
            figure.limit_m.map(|limit| format!("limit {:.3} µm", limit * 1e6)),
            figure.verdict.map(|(verdict, rule)| {
                format!("{}; decision rule: {}", verdict_word(verdict).replace('_', " "), rule.words())
            }),
        ];
        let said = said.into_iter().flatten().collect::<Vec<_>>().join(": ");
        let _ = write!(out, "<dcc:result>{}", name(&figure.name));
        if !said.is_empty() {
            let _ = write!(out, "<dcc:description>{}</dcc:description>", content(&said));
        }
        let _ = write!(
            out,
            "<dcc:data><dcc:quantity><si:real><si:value>{:.4}</si:value><si:unit>\\micro\\metre</si:unit>",
            figure.value_m * 1e6
        );
        if let Some(expanded_m) = figure.expanded_m {
            let _ = write!(
                out,
                "<si:expandedUnc><si:uncertainty>{:.4}</si:uncertainty><si:coverageFactor>2</si:coverageFactor>\
                 <si:coverageProbability>{PROBABILITY}</si:coverageProbability></si:expandedUnc>",
                expanded_m * 1e6
            );
        }
        out.push_str("</si:real></dcc:quantity></dcc:data></dcc:result>\n");
    }
    out.push_str("</dcc:results></dcc:measurementResult></dcc:measurementResults>\n");
}

/// The program with its release, as PTB's rules want one written.
fn program() -> String {
    format!("<dcc:software>{}<dcc:release>v{}</dcc:release></dcc:software>", name("Abbe"), env!("CARGO_PKG_VERSION"))
}

/// The temperature of the measurement. PTB's rules want what influenced it said; where nobody stated it, that is said.
fn conditions(who: &Who, out: &mut String) {
    let quantity = |what: &str, celsius: f64| {
        format!(
            "<dcc:quantity>{}<si:real><si:value>{celsius:.2}</si:value><si:unit>\\degreecelsius</si:unit></si:real></dcc:quantity>",
            name(what)
        )
    };
    let data = match who.shown.temperature_c {
        Some([low, high]) => quantity("lowest temperature", low) + &quantity("highest temperature", high),
        None => format!("<dcc:text>{}</dcc:text>", content("not stated")),
    };
    let _ = writeln!(
        out,
        "<dcc:influenceConditions><dcc:influenceCondition>{}<dcc:data>{data}</dcc:data></dcc:influenceCondition>\
         </dcc:influenceConditions>",
        name("Temperature")
    );
}

/// What the schema demands.
struct Wanted {
    certificate: String,
    measured: String,
    operator: String,
    maker: String,
    model: String,
    serial_number: String,
    country: String,
    laboratory: Contact,
    customer: Contact,
}

impl Wanted {
    fn of(who: &Who) -> anyhow::Result<Wanted> {
        let Who { shown, stated } = who;
        let mut missing: Vec<String> = Vec::new();
        let mut want = |key: &str, value: Option<&String>| {
            if value.is_none_or(|value| value.trim().is_empty()) {
                missing.push(key.to_owned());
            }
            value.cloned().unwrap_or_default()
        };
        let certificate = want("certificate", stated.certificate.as_ref());
        let measured = want("measured", shown.measured.as_ref());
        let operator = want("operator", shown.operator.as_ref());
        let maker = want("maker", stated.maker.as_ref());
        let model = want("model", stated.model.as_ref());
        let serial_number = want("serial_number", stated.serial_number.as_ref());
        let mut of = |key: &str, contact: &Option<Contact>| {
            let contact = contact.clone().unwrap_or_default();
            want(&format!("{key}.name"), Some(&contact.name));
            want(&format!("{key}.email"), contact.email.as_ref());
            want(&format!("{key}.city"), contact.city.as_ref());
            contact
        };
        let laboratory = of("laboratory", &stated.laboratory);
        let customer = of("customer", &stated.customer);
        let country = want("laboratory.country", laboratory.country.as_ref());
        let list = missing.join(", ");
        ensure!(
            missing.is_empty(),
            "the schema of the certificate demands what is not stated; add to [identity]: {list}"
        );
        Ok(Wanted { certificate, measured, operator, maker, model, serial_number, country, laboratory, customer })
    }
}

/// Text of an element: characters that XML forbids become blanks.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if c.is_control() || matches!(c as u32, 0xFFFE | 0xFFFF) => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// The schema's word; it has one for "not at these", and none for "not stated".
fn performed_at(place: Option<PerformedAt>) -> &'static str {
    match place {
        Some(PerformedAt::Laboratory) => "laboratory",
        Some(PerformedAt::LaboratoryBranch) => "laboratoryBranch",
        Some(PerformedAt::Customer) => "customer",
        Some(PerformedAt::CustomerBranch) => "customerBranch",
        Some(PerformedAt::Other) | None => "other",
    }
}

fn content(text: &str) -> String {
    format!("<dcc:content lang=\"en\">{}</dcc:content>", escape(text))
}

fn name(text: &str) -> String {
    format!("<dcc:name>{}</dcc:name>", content(text))
}

/// Name, mail and address.
fn contact(contact: &Contact) -> String {
    let places = [
        ("street", &contact.street),
        ("postCode", &contact.post_code),
        ("city", &contact.city),
        ("countryCode", &contact.country),
    ];
    let place =
        |(key, value): (&str, &Option<String>)| Some(format!("<dcc:{key}>{}</dcc:{key}>", escape(value.as_deref()?)));
    let location: String = places.into_iter().filter_map(place).collect();
    let email = escape(contact.email.as_deref().unwrap_or_default());
    format!("{}<dcc:eMail>{email}</dcc:eMail><dcc:location>{location}</dcc:location>", name(&contact.name))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)] // a test

    use super::*;
    use crate::conformity::Figure;
    use abbe_conformity::{DecisionRule, Verdict};
    use abbe_report::{Identity, Report};
    use std::process::Command;

    fn product() -> Product {
        let figure = |value_m, expanded_m| Figure {
            name: "E0 <largest> & more".to_owned(),
            value_m,
            expanded_m,
            limit_m: Some(3.3e-6),
            verdict: Some((Verdict::Conforms, DecisionRule::SimpleAcceptance)),
        };
        Product {
            words: String::new(),
            json: serde_json::Value::Null,
            report: Report { title: "Length".to_owned(), lead: Some("7 lines".to_owned()), ..Report::default() },
            verdict: None,
            outside: None,
            figures: vec![figure(-0.58e-6, Some(0.31e-6)), figure(0.3e-6, None)],
            method: ("ISO 10360-2", vec!["line <a>: too short".to_owned()]),
        }
    }

    fn who() -> Who {
        let some = |text: &str| Some(text.to_owned());
        let contact = |named: &str| Contact {
            name: named.to_owned(),
            email: some("a@b.example"),
            street: some("Street 1"),
            city: some("Town"),
            country: some("DE"),
            ..Contact::default()
        };
        let stated = abbe_files::Identity {
            certificate: some("2026-014"),
            maker: some("Maker"),
            model: some("M 7"),
            serial_number: some("4711"),
            instrument: Some(abbe_files::InstrumentIdentity {
                name: some("Step gauge"),
                serial_number: some("K-77"),
                ..Default::default()
            }),
            laboratory: Some(contact("Laboratory")),
            customer: Some(contact("Customer")),
            ..abbe_files::Identity::default()
        };
        let shown =
            Identity { operator: some("A. Person"), measured: some("2026-03-05/2026-03-06"), ..Identity::default() };
        Who { shown, stated }
    }

    #[test]
    fn what_the_schema_demands_is_refused_by_its_keys() {
        let mut lacking = who();
        lacking.stated.serial_number = None;
        lacking.stated.customer = Some(Contact { name: "C".to_owned(), ..Contact::default() });
        lacking.shown.operator = None;
        let error = text(&lacking, &product()).unwrap_err().to_string();
        assert!(error.ends_with("operator, serial_number, customer.email, customer.city"), "{error}");
    }

    #[test]
    fn values_stand_in_si_with_their_uncertainty_where_it_is_known() {
        let text = text(&who(), &product()).unwrap();
        assert!(text.contains(
            "<si:value>-0.5800</si:value><si:unit>\\micro\\metre</si:unit><si:expandedUnc><si:uncertainty>0.3100"
        ));
        assert_eq!(text.matches("<si:expandedUnc>").count(), 1, "an uncertainty that nobody stated is not written");
        assert!(text.contains("<dcc:performanceLocation>other<"), "nobody said where");
        let mut at_customer = who();
        at_customer.stated.performed_at = Some(PerformedAt::CustomerBranch);
        let elsewhere = super::text(&at_customer, &product()).unwrap();
        assert!(elsewhere.contains("<dcc:performanceLocation>customerBranch<"));
        assert!(text.contains("E0 &lt;largest&gt; &amp; more") && text.contains("<dcc:endPerformanceDate>2026-03-06<"));
    }

    /// The schema is under the LGPL and no part of this tree: `ABBE_DCC_SCHEMA` names a copy of `dcc.xsd`, version 3.1.2, whose
    /// import of `SI_Format.xsd` leads to a file.
    #[test]
    fn val_ptb_schema_accepts_the_certificate() {
        let Some(schema) = std::env::var_os("ABBE_DCC_SCHEMA") else {
            eprintln!("SKIPPED: ABBE_DCC_SCHEMA names no copy of PTB's dcc.xsd 3.1.2");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let judged = |text: &str| {
            let file = folder.path().join("dcc.xml");
            std::fs::write(&file, text).unwrap();
            let run =
                Command::new("xmllint").arg("--nonet").arg("--noout").arg("--schema").arg(&schema).arg(&file).output();
            run.unwrap_or_else(|error| panic!("xmllint: {error}; it is in Debian's libxml2-utils"))
        };
        let text = text(&who(), &product()).unwrap();
        let found = judged(&text);
        assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
        assert!(!judged(&text.replace("<si:unit>\\micro\\metre</si:unit>", "")).status.success(), "it can refuse");
    }
}
