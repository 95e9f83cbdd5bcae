classdef suj < trocar.instance
    % The setup joints of a patient cart: s = trocar.suj(); s.PSM1.measured_cp(), or s.arm('PSM1').

    properties (SetAccess = protected)
        PSM1  % setup arms; empty where there is none
        PSM2
        PSM3
        ECM
    end

    properties (Access = private)
        found
    end

    methods

        function self = suj(varargin)
            % SUJ unless another name is given.
            if nargin == 0, varargin = {'SUJ'}; end
            self@trocar.instance(varargin{:});
            self.must_be('suj');
            self.found = containers.Map('KeyType', 'char', 'ValueType', 'any');
            topics = self.bridge.ask(struct('op', 'list'));
            for k = 1:numel(topics.topics)
                parts = strsplit(topics.topics(k).topic, '/');
                if numel(parts) == 3 && strcmp(parts{1}, self.name) && strcmp(parts{3}, 'measured_js')
                    made = trocar.suj_arm(self.bridge, self.name, parts{2});
                    self.found(parts{2}) = made;
                    if any(strcmp(parts{2}, {'PSM1', 'PSM2', 'PSM3', 'ECM'}))
                        self.(parts{2}) = made;
                    end
                end
            end
        end

        function names = arms(self)
            % Names of its arms: a cell array.
            names = keys(self.found);
        end

        function result = arm(self, name)
            % One of them; trocar:argument says which there are.
            if ~isKey(self.found, name)
                error('trocar:argument', 'there is no setup arm %s; there are %s', name, strjoin(self.arms(), ', '));
            end
            result = self.found(name);
        end

        function name = reference_arm(self)
            % The setup arm in the tip of whose arm base frames are given.
            row = self.state();
            name = row.reference_arm;
        end

        function set_reference_arm(self, name)
            % Give base frames in the tip of the arm on this one from now on.
            self.bridge.command(self.name, 'set_reference_arm', [], name);
        end

        function set_lift_velocity(self, velocity)
            % Move the lift, -1 down to 1 up, for a second at most; 0: stop.
            self.bridge.command(self.name, 'set_lift_velocity', velocity);
        end

    end

end
