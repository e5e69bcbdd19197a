package Modelica "Names of the Modelica Standard Library that plain models use: units, constants, functions, signals"
  package Units "SI units"
    package SI "SI units"
      type Angle = Real(final quantity = "Angle", final unit = "rad");
      type Length = Real(final quantity = "Length", final unit = "m", min = 0);
      type Distance = Real(final quantity = "Distance", final unit = "m", min = 0);
      type Position = Real(final quantity = "Position", final unit = "m");
      type Height = Real(final quantity = "Height", final unit = "m", min = 0);
      type Thickness = Real(final quantity = "Thickness", final unit = "m", min = 0);
      type Radius = Real(final quantity = "Radius", final unit = "m", min = 0);
      type Diameter = Real(final quantity = "Diameter", final unit = "m", min = 0);
      type Breadth = Real(final quantity = "Breadth", final unit = "m", min = 0);
      type Area = Real(final quantity = "Area", final unit = "m2");
      type Volume = Real(final quantity = "Volume", final unit = "m3");
      type Time = Real(final quantity = "Time", final unit = "s");
      type Duration = Real(final quantity = "Duration", final unit = "s");
      type Velocity = Real(final quantity = "Velocity", final unit = "m/s");
      type Speed = Real(final quantity = "Speed", final unit = "m/s");
      type Acceleration = Real(final quantity = "Acceleration", final unit = "m/s2");
      type AngularVelocity = Real(final quantity = "AngularVelocity", final unit = "rad/s");
      type AngularAcceleration = Real(final quantity = "AngularAcceleration", final unit = "rad/s2");
      type AngularFrequency = Real(final quantity = "AngularFrequency", final unit = "rad/s");
      type Frequency = Real(final quantity = "Frequency", final unit = "Hz");
      type Period = Real(final quantity = "Period", final unit = "s");
      type DampingCoefficient = Real(final quantity = "DampingCoefficient", final unit = "s-1");
      type Mass = Real(final quantity = "Mass", final unit = "kg", min = 0);
      type Density = Real(final quantity = "Density", final unit = "kg/m3");
      type MomentOfInertia = Real(final quantity = "MomentOfInertia", final unit = "kg.m2");
      type Inertia = Real(final quantity = "Inertia", final unit = "kg.m2");
      type Momentum = Real(final quantity = "Momentum", final unit = "kg.m/s");
      type Impulse = Real(final quantity = "Impulse", final unit = "N.s");
      type AngularMomentum = Real(final quantity = "AngularMomentum", final unit = "kg.m2/s");
      type Force = Real(final quantity = "Force", final unit = "N");
      type Torque = Real(final quantity = "Torque", final unit = "N.m");
      type MomentOfForce = Real(final quantity = "MomentOfForce", final unit = "N.m");
      type TranslationalSpringConstant = Real(final quantity = "TranslationalSpringConstant", final unit = "N/m", min = 0);
      type TranslationalDampingConstant = Real(final quantity = "TranslationalDampingConstant", final unit = "N.s/m", min = 0);
      type RotationalSpringConstant = Real(final quantity = "RotationalSpringConstant", final unit = "N.m/rad", min = 0);
      type RotationalDampingConstant = Real(final quantity = "RotationalDampingConstant", final unit = "N.m.s/rad", min = 0);
      type Pressure = Real(final quantity = "Pressure", final unit = "Pa");
      type AbsolutePressure = Real(final quantity = "AbsolutePressure", final unit = "Pa");
      type PressureDifference = Real(final quantity = "PressureDifference", final unit = "Pa");
      type Stress = Real(final quantity = "Stress", final unit = "Pa");
      type NormalStress = Real(final quantity = "NormalStress", final unit = "Pa");
      type ShearStress = Real(final quantity = "ShearStress", final unit = "Pa");
      type ModulusOfElasticity = Real(final quantity = "ModulusOfElasticity", final unit = "Pa");
      type YoungModulus = Real(final quantity = "YoungModulus", final unit = "Pa");
      type DynamicViscosity = Real(final quantity = "DynamicViscosity", final unit = "Pa.s");
      type KinematicViscosity = Real(final quantity = "KinematicViscosity", final unit = "m2/s");
      type Work = Real(final quantity = "Work", final unit = "J");
      type Energy = Real(final quantity = "Energy", final unit = "J");
      type KineticEnergy = Real(final quantity = "KineticEnergy", final unit = "J");
      type PotentialEnergy = Real(final quantity = "PotentialEnergy", final unit = "J");
      type Heat = Real(final quantity = "Heat", final unit = "J");
      type Power = Real(final quantity = "Power", final unit = "W");
      type Temperature = Real(final quantity = "Temperature", final unit = "K");
      type ThermodynamicTemperature = Real(final quantity = "ThermodynamicTemperature", final unit = "K");
      type TemperatureDifference = Real(final quantity = "TemperatureDifference", final unit = "K");
      type HeatFlowRate = Real(final quantity = "HeatFlowRate", final unit = "W");
      type HeatFlux = Real(final quantity = "HeatFlux", final unit = "W/m2");
      type ThermalConductivity = Real(final quantity = "ThermalConductivity", final unit = "W/(m.K)");
      type ThermalConductance = Real(final quantity = "ThermalConductance", final unit = "W/K");
      type ThermalResistance = Real(final quantity = "ThermalResistance", final unit = "K/W");
      type HeatCapacity = Real(final quantity = "HeatCapacity", final unit = "J/K");
      type SpecificHeatCapacity = Real(final quantity = "SpecificHeatCapacity", final unit = "J/(kg.K)");
      type CoefficientOfHeatTransfer = Real(final quantity = "CoefficientOfHeatTransfer", final unit = "W/(m2.K)");
      type MassFlowRate = Real(final quantity = "MassFlowRate", final unit = "kg/s");
      type VolumeFlowRate = Real(final quantity = "VolumeFlowRate", final unit = "m3/s");
      type AmountOfSubstance = Real(final quantity = "AmountOfSubstance", final unit = "mol");
      type ElectricCurrent = Real(final quantity = "ElectricCurrent", final unit = "A");
      type Current = Real(final quantity = "Current", final unit = "A");
      type ElectricCharge = Real(final quantity = "ElectricCharge", final unit = "C");
      type Charge = Real(final quantity = "Charge", final unit = "C");
      type ElectricPotential = Real(final quantity = "ElectricPotential", final unit = "V");
      type Voltage = Real(final quantity = "Voltage", final unit = "V");
      type PotentialDifference = Real(final quantity = "PotentialDifference", final unit = "V");
      type ElectricFieldStrength = Real(final quantity = "ElectricFieldStrength", final unit = "V/m");
      type Resistance = Real(final quantity = "Resistance", final unit = "Ohm");
      type Conductance = Real(final quantity = "Conductance", final unit = "S");
      type Capacitance = Real(final quantity = "Capacitance", final unit = "F", min = 0);
      type Inductance = Real(final quantity = "Inductance", final unit = "H");
      type MagneticFlux = Real(final quantity = "MagneticFlux", final unit = "Wb");
      type MagneticFluxDensity = Real(final quantity = "MagneticFluxDensity", final unit = "T");
      type Impedance = Real(final quantity = "Impedance", final unit = "Ohm");
      type Reactance = Real(final quantity = "Reactance", final unit = "Ohm");
      type Efficiency = Real(final quantity = "Efficiency", final unit = "1");
      type DimensionlessRatio = Real(final quantity = "DimensionlessRatio", final unit = "1");
      type PerUnit = Real(final quantity = "PerUnit", final unit = "1");
      type Damping = Real(final quantity = "Damping", final unit = "s-1");
    end SI;
  end Units;
  package SIunits = Units.SI;
  package Constants "Mathematical and physical constants"
    final constant Real pi = 3.14159265358979323846 "circumference of a circle over its diameter";
    final constant Real e = 2.71828182845904523536 "base of natural logarithms";
    final constant Real eps = 2.220446049250313e-16 "distance from 1 to the next number";
    final constant Real small = 1e-60 "smallest number to count with";
    final constant Real inf = 1e60 "largest number to count with";
    final constant Real g_n = 9.80665 "standard gravity [m/s2]";
    final constant Real D2R = 0.017453292519943295 "radians in a degree";
    final constant Real R2D = 57.29577951308232 "degrees in a radian";
    final constant Real R = 8.31446261815324 "gas constant [J/(mol.K)]";
    final constant Real sigma = 5.670374419184429e-8 "Stefan-Boltzmann constant [W/(m2.K4)]";
    final constant Real c = 299792458.0 "speed of light [m/s]";
    final constant Real q = 1.602176634e-19 "elementary charge [C]";
    final constant Real k = 1.380649e-23 "Boltzmann constant [J/K]";
    final constant Real mu_0 = 1.25663706212e-6 "magnetic constant [N/A2]";
    final constant Real epsilon_0 = 8.8541878128e-12 "electric constant [F/m]";
    final constant Real T_zero = -273.15 "absolute zero [degC]";
  end Constants;
  package Math "Elementary functions; the compiler puts its own in their place"
    function sin
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.sin(u);
    end sin;
    function cos
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.cos(u);
    end cos;
    function tan
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.tan(u);
    end tan;
    function asin
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.asin(u);
    end asin;
    function acos
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.acos(u);
    end acos;
    function atan
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.atan(u);
    end atan;
    function sinh
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.sinh(u);
    end sinh;
    function cosh
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.cosh(u);
    end cosh;
    function tanh
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.tanh(u);
    end tanh;
    function exp
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.exp(u);
    end exp;
    function log
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.log(u);
    end log;
    function log10
      input Real u;
      output Real y;
    algorithm
      y := Modelica.Math.log10(u);
    end log10;
    function atan2
      input Real u1;
      input Real u2;
      output Real y;
    algorithm
      y := Modelica.Math.atan2(u1, u2);
    end atan2;
  end Math;
  package Blocks "Signals"
    package Interfaces "Causal connectors"
      connector RealInput = input Real "Input signal";
      connector RealOutput = output Real "Output signal";
      connector BooleanInput = input Boolean "Input signal";
      connector BooleanOutput = output Boolean "Output signal";
      connector IntegerInput = input Integer "Input signal";
      connector IntegerOutput = output Integer "Output signal";
      partial block SO "Single output"
        RealOutput y "Output signal";
      end SO;
      partial block SISO "Single input, single output"
        RealInput u "Input signal";
        RealOutput y "Output signal";
      end SISO;
    end Interfaces;
  end Blocks;
end Modelica;
