"""Judges a Digital Calibration Certificate by PTB's rules.

Usage: certificate.py CERTIFICATE.xml ...

Three judges. PTB's own: the Schematron rules that PyPI `dcclib` carries (schema 3.3.0, of which every rule but that on the version
holds for 3.1.2 too). And the rules of the XML schema 3.1.2 and of D-SI 2.1.0 that a certificate of Abbe meets, written here:
which elements stand in what, in which order, and the form of values. And the schema itself, where `ABBE_DCC_SCHEMA` names a copy:
`.ci/run` fetches one from PTB where there is a network.

Prints one line of JSON: for each certificate "schematron", "structure" and "schema", lists of what is wrong; "schema" is null without one.
"""

import json
import os
import re
import sys
import xml.etree.ElementTree as tree

import lxml.etree
from dcclib.validation import SchematronValidator

# Elements that an element may hold, in order; + at least once, * any number, ? at most once, else exactly once.
ORDER = {
    "digitalCalibrationCertificate": "administrativeData measurementResults",
    "administrativeData": "dccSoftware coreData items calibrationLaboratory respPersons customer",
    "dccSoftware": "software+",
    "usedSoftware": "software+",
    "software": "name release description?",
    "coreData": "countryCodeISO3166_1 usedLangCodeISO639_1+ mandatoryLangCodeISO639_1+ uniqueIdentifier receiptDate? "
    "beginPerformanceDate endPerformanceDate performanceLocation",
    "items": "item+",
    "item": "name description? manufacturer model? identifications",
    "identifications": "identification+",
    "identification": "issuer value name?",
    "calibrationLaboratory": "contact",
    "contact": "name eMail phone? fax? location",
    "customer": "name eMail phone? fax? location",
    "manufacturer": "name eMail? phone? fax? location?",
    "person": "name eMail? phone? fax? location?",
    "respPersons": "respPerson+",
    "respPerson": "person description? role? mainSigner?",
    "measurementResults": "measurementResult+",
    "measurementResult": "name description? usedMethods? usedSoftware? measuringEquipments? influenceConditions? results",
    "usedMethods": "usedMethod+",
    "usedMethod": "name description? norm* reference*",
    "measuringEquipments": "measuringEquipment+",
    "measuringEquipment": "name description? manufacturer? model? identifications?",
    "influenceConditions": "influenceCondition+",
    "influenceCondition": "name description? data",
    "results": "result+",
    "result": "name description? data",
    "quantity": "name? description? real",
    "real": "label? value unit expandedUnc?",
    "expandedUnc": "uncertainty coverageFactor coverageProbability distribution?",
    "name": "content+",
    "description": "content+",
    "text": "content+",
}
# Any number of these, in any order.
CHOICE = {
    "location": {"city", "countryCode", "postCode", "postOfficeBox", "state", "street", "streetNo"},
    "data": {"text", "quantity"},
}
NUMBER = r"((\d*\.\d+)|(\d+\.?))([Ee][-+]?\d+)?"
DAY = r"\d{4}-\d\d-\d\d"
FORM = {
    "value": rf"[-+]?{NUMBER}",  # of si:real
    "uncertainty": NUMBER,
    "coverageFactor": r"[1-9]\d*(\.\d*)?",
    "coverageProbability": r"0(\.\d*)?|1(\.0*)?",
    "unit": r"(\\[a-z]+)+",
    "countryCodeISO3166_1": "[A-Z]{2}",
    "countryCode": "[A-Z]{2}",
    "usedLangCodeISO639_1": "[a-z]{2}",
    "mandatoryLangCodeISO639_1": "[a-z]{2}",
    "beginPerformanceDate": DAY,
    "endPerformanceDate": DAY,
    "performanceLocation": "laboratory|customer|laboratoryBranch|customerBranch|other",
    "issuer": "manufacturer|calibrationLaboratory|customer|owner|other",
    "mainSigner": "true|false",
}
# Units of D-SI that a certificate of Abbe has.
UNITS = {r"\micro\metre", r"\degreecelsius"}


def wrong(element, parent=None):
    """What is wrong in an element and below it."""
    space, _, name = element.tag[1:].partition("}")
    inside_real = parent in ("real", "expandedUnc")
    if space != ("https://ptb.de/si" if name == "real" or inside_real else "https://ptb.de/dcc"):
        yield f"{name} in {parent} is of {space}"
    children = [child.tag.partition("}")[2] for child in element]
    if name in ORDER:
        words = ORDER[name].split()
        pattern = "".join(f"({word.rstrip('+*?')} ){word[len(word.rstrip('+*?')):]}" for word in words)
        if not re.fullmatch(pattern, "".join(child + " " for child in children)):
            yield f"{name} holds {children}, wanted is {ORDER[name]}"
    elif name in CHOICE:
        if not children or not set(children) <= CHOICE[name]:
            yield f"{name} holds {children}, wanted are some of {sorted(CHOICE[name])}"
    elif children:
        yield f"{name} holds {children}, wanted is text"
    else:
        text = element.text or ""
        form = FORM.get(name) if name != "value" or inside_real else None
        if not text.strip() or (form and not re.fullmatch(form, text)):
            yield f"{name}: {text!r}"
        if name == "unit" and text not in UNITS:
            yield f"unit {text!r} is none of {sorted(UNITS)}"
    for child in element:
        yield from wrong(child, name)


def judged(path, validator):
    root = tree.parse(path).getroot()
    structure = list(wrong(root))
    if root.get("schemaVersion") != "3.1.2":
        structure.append(f"schemaVersion {root.get('schemaVersion')}")
    by_ptb = validator.validate_file(path)
    found = by_ptb.failed_assertions + by_ptb.successful_reports
    schematron = [f"{report.location}: {report.text}" for report in found if report.role == "error"]
    return {"schematron": schematron, "structure": structure, "schema": by_schema(path)}


def by_schema(path):
    """What PTB's schema finds wrong; None without it."""
    if schema is None:
        return None
    schema.validate(lxml.etree.parse(path))
    return [f"line {entry.line}: {entry.message}" for entry in schema.error_log]


named = os.environ.get("ABBE_DCC_SCHEMA")
schema = lxml.etree.XMLSchema(file=named) if named else None
rules = SchematronValidator.for_dcc()
print(json.dumps([judged(path, rules) for path in sys.argv[1:]]))
