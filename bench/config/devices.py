"""Entry of one instrument in a bench file: the blocks common to all drivers, and the driver's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails

from bench.config.dcc import ReadCertificate, with_certificate
from drivers.can.sent_frames import Encoder, Output
from drivers.description import DriverDescription, IdentityPin, known_drivers
from drivers.quantity.units import quoted
from drivers.safe_state import LONGEST_S, SafeState
from drivers.schema.fields import Date, Number, Spelled, StrictModel, inner_errors, note_named
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import expected, problem_at, telling
from drivers.transport.address import Address, AddressError

Text = Annotated[str, Field(min_length=1, max_length=200)]
CoverageFactor = Annotated[Number, Field(gt=0, le=4)]


class Calibration(StrictModel):
    """Calibration certificate.

    `U` holds expanded uncertainties, and `corrections` holds values to be added to readings, under the names that the
    driver or the reading gives them.
    """

    dcc: ReadCertificate = Field(
        None, description="its file, a Digital Calibration Certificate; then only what it lacks is stated here"
    )
    signed_by: str | None = Field(
        None, description="with dcc: certificates in PEM, by one of which it must be signed; without, a signature need "
        "not be there",
    )  # fmt: skip
    quantities: Mapping[str, Text] = Field(
        {}, description="with dcc: the id, refType or name of a quantity in it, by key; without, itb_KEY"
    )
    serial: Spelled | None = Field(None, description="with dcc: serial number in it, if not that under identity")
    certificate: Text = Field(description="its number")
    laboratory: Text = Field(description="who issued it")
    date: Date = Field(description="of the calibration")
    due: Date = Field(description="of the next one")
    k: CoverageFactor = Field(2.0, description="coverage factor of all in U")
    U: Any = Field(default_factory=dict, description="expanded uncertainties; its keys are the driver's")
    corrections: Any = Field(
        default_factory=dict, description="corrections added to readings; its keys are the driver's"
    )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema in which a certificate file stands for its number, laboratory and dates."""
        found = handler.resolve_ref_schema(handler(schema))
        required = found.pop("required")
        found["anyOf"] = [{"required": required}, {"required": ["dcc"]}]
        return found

    @model_validator(mode="after")
    def _due_after_it_was_made(self) -> Self:
        if self.due <= self.date:
            raise telling(f"is due on {self.due}, which is not after its date {self.date}")
        return self


def _known_driver(name: str) -> str:
    if name not in known_drivers():
        raise telling(f"there is no driver {quoted(name)}{did_you_mean(name, known_drivers())}")
    return name


def _address(raw: object, info: ValidationInfo) -> Address:
    if not isinstance(raw, str):
        raise expected("an address like tcp://192.168.1.10:502", raw)
    try:
        address = Address.parse(raw)
    except AddressError as problem:
        raise telling(str(problem)) from None
    context = info.context or {}
    if address.is_recording and isinstance(folder := context.get("folder"), Path):
        note_named(address.path, context)
        return replace(address, path=str(folder / address.path))  # relative to the bench file, as all its files
    return address


class DeviceEntry(StrictModel):
    """Instrument; the blocks `options`, `limits`, `safe`, `calibration.U` and its corrections are the driver's."""

    driver: Annotated[str, AfterValidator(_known_driver)] = Field(description="the name of an installed driver")
    connection: Annotated[Address, BeforeValidator(_address), WithJsonSchema({"type": "string"})] = Field(
        description="an address like tcp://192.168.1.10:502"
    )
    options: Any = Field(None, description="how the instrument is used; its keys are the driver's")
    identity: IdentityPin = IdentityPin()
    limits: Any = Field(None, description="permitted ranges on this bench; its keys are the driver's")
    safe: Any = Field(None, description="the safe state; its keys are the driver's")
    calibration: Calibration | None = None

    @property
    def description(self) -> DriverDescription:
        """Description of the driver."""
        return known_drivers()[self.driver]

    @property
    def channels(self) -> Mapping[str, str]:
        """Units of the readings, by channel."""
        return self.description.channels_of(self.options)

    @property
    def outputs(self) -> Mapping[str, Output]:
        """Channels on which the device sends outputs of units unsolicited; empty for a device that is polled."""
        frames = self.description.frames
        return {} if frames is None else frames.outputs(self.options)

    @property
    def encoders(self) -> Mapping[str, Encoder]:
        """Encoders that are latched with the outputs, by the devices that drive their axes."""
        frames = self.description.frames
        return {} if frames is None else frames.encoders(self.options)

    @property
    def files(self) -> Mapping[str, Path]:
        """Files that the options refer to, such as a DBC file, by key."""
        return {key: value for key, value in self.options or () if isinstance(value, Path)}

    @property
    def safe_state(self) -> SafeState:
        """Action of making the device safe, and its time limit."""
        return self.description.safe_state_of(self.options, self.limits, self.safe)

    @property
    def busy_s(self) -> float:
        """Longest time in s without a reading in normal operation."""
        return self.description.busy_s_of(self.options, self.limits)

    @model_validator(mode="wrap")
    @classmethod
    def _with_driver_blocks(cls, data: Any, handler: ModelWrapValidatorHandler[Any], info: ValidationInfo) -> Any:
        """Validate all blocks together, so that a misspelt key does not hide problems in a block of the driver."""
        entry: DeviceEntry | None = None
        blocks: dict[str, BaseModel] = {}
        problems: list[InitErrorDetails] = []
        data = _with_certificate(data, info, problems)
        try:
            entry = handler(data)
        except ValidationError as error:
            problems += inner_errors(error)
        if isinstance(data, Mapping) and isinstance(driver := data.get("driver"), str):
            description = known_drivers().get(driver)
            if description is not None:
                blocks = _blocks(description, data, info, problems)
                problems += _misfits(description, entry, blocks)
        if problems or entry is None:
            raise ValidationError.from_exception_data(cls.__name__, problems)
        update: dict[str, Any] = {name: blocks[name] for name in ("options", "limits", "safe")}
        if entry.calibration is not None:
            own = {name: blocks[name] for name in ("U", "corrections")}
            update["calibration"] = entry.calibration.model_copy(update=own)
        return entry.model_copy(update=update)


def _with_certificate(data: Any, info: ValidationInfo, problems: list[InitErrorDetails]) -> Any:
    """Return an entry with the values of the certificate that it names; its problems are appended to `problems`."""
    if not isinstance(data, Mapping) or not isinstance(calibration := data.get("calibration"), Mapping):
        return data
    description = known_drivers().get(str(data.get("driver")))
    if description is None:
        return data
    identity = data.get("identity")
    serial = identity.get("serial") if isinstance(identity, Mapping) else None
    models = description.uncertainty, description.corrections
    try:
        return {**data, "calibration": with_certificate(calibration, *models, serial, info)}
    except ValidationError as error:
        problems += inner_errors(error, ("calibration",))
        return {name: block for name, block in data.items() if name != "calibration"}


def _blocks(
    description: DriverDescription, data: Mapping[str, Any], info: ValidationInfo, problems: list[InitErrorDetails]
) -> dict[str, BaseModel]:
    """Return the valid blocks of a driver; problems of the others are appended to `problems`."""
    blocks: dict[str, BaseModel] = {}
    own: list[tuple[tuple[str, ...], type[BaseModel], Mapping[str, Any]]] = [
        (("options",), description.options, data),
        (("limits",), description.limits, data),
        (("safe",), description.safe, data),
    ]
    if isinstance(certificate := data.get("calibration"), Mapping):
        own.append((("calibration", "U"), description.uncertainty, certificate))
        own.append((("calibration", "corrections"), description.corrections, certificate))
    for place, model, around in own:
        name = place[-1]
        if name not in around and any(field.is_required() for field in model.model_fields.values()):
            problems.append(problem_at(place, "is missing"))
            continue
        try:
            blocks[name] = model.model_validate(around.get(name, {}), context=info.context)
        except ValidationError as error:
            problems += inner_errors(error, place)
    return blocks


def _misfits(
    description: DriverDescription, entry: DeviceEntry | None, blocks: Mapping[str, BaseModel]
) -> Iterator[InitErrorDetails]:
    """Yield unusable addresses, and settings outside the limits of the entry."""
    if entry is not None and (scheme := entry.connection.scheme) not in description.schemes:
        known = " or ".join(sorted(description.schemes))
        yield problem_at(("connection",), f"{description.name} is reached by {known}, not by {scheme}")
    limits = blocks.get("limits")
    for block in ("options", "safe"):
        for name, value in blocks.get(block) or ():
            beyond = _beyond(getattr(limits, name, None), value)
            if beyond and name in blocks[block].model_fields_set:
                yield problem_at((block, name), f"is {beyond} of limits.{name}")
            elif beyond:
                problem = f"does not include the default of {block}.{name}; give {block}.{name} as well"
                yield problem_at(("limits", name), problem)
    if {"options", "limits", "safe"} <= blocks.keys():
        state = description.safe_state_of(blocks["options"], blocks["limits"], blocks["safe"])
        if state.within_s > LONGEST_S:
            yield problem_at(
                ("limits",), f"making it safe ({state.words}) could take {state.within_s:g} s, at most "
                f"{LONGEST_S:g} s are allowed; raise options.acceleration or lower limits.rate",
            )  # fmt: skip


def _beyond(allowed: object, value: float) -> str:
    """Return the side on which `value` is outside a range, "" if it is inside."""
    low, high = getattr(allowed, "min", None), getattr(allowed, "max", None)
    if low is not None and value < low:
        return "below the min"
    return "above the max" if high is not None and value > high else ""
